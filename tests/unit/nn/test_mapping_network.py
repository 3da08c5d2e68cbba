import torch

from dancediff.nn.mapping_network import MappingNetwork


def test_each_row_is_answered_by_the_head_of_its_genre():
    torch.manual_seed(0)
    network, x = MappingNetwork(8, 4, num_genres=3), torch.randn(2, 8)
    genre = torch.tensor([2, 0])
    assert torch.equal(network.of_genre(x, genre), network(x)[[0, 1], [2, 0]])
    network.of_genre(x, genre).sum().backward()
    learned = [head[0].weight.grad.any().item() for head in network.heads]
    assert learned == [True, False, True]
